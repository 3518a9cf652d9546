"""Figures: every module here with a ``@run_figure`` is drawn for every run."""
