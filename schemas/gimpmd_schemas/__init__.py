"""The contract between the services: case file, messages, background grid, zones."""
