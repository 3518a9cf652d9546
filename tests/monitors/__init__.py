"""What the monitors say of disasters, and that they are silent in sound runs."""
