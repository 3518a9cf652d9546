"""The command ``gimpmd``: one module for each command."""
