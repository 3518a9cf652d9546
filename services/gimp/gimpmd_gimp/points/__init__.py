"""Material points: arrays, distribution over ranks, splitting and merging, groups, the body."""
