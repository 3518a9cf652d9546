"""Random faults in real runs: nothing may be lost beyond the last checkpoint."""
