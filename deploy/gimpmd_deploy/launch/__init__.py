"""Launch: from a case file to a finished run, with every process watched."""
