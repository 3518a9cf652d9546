"""Any calculator of the Atomic Simulation Environment (ASE) as the forces between the atoms."""
