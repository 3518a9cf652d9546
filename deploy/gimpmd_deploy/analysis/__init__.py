"""What a run shows: crack tip and energy release, slip pulses and Mach lines, stress of atoms."""
