"""Material points: their arrays, distribution over ranks, splitting and merging."""
