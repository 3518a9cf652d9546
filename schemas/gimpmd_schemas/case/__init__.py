"""What a run is: the case file, its checks, and the plan that services read."""
