"""The command line: prepares a case, starts and watches its services, draws and reports."""
