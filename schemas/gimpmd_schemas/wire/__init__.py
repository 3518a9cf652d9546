"""What travels between processes: messages, fields, energies, events, answers."""
