"""Coverage-guided fuzzing of what is read from the bus."""
