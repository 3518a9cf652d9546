"""Runs on a Slurm cluster of two hosts inside one machine."""
