"""Checks a service: plays the coupler and the other side, and looks at what the service does.

``python -m gimpmd_coupler.check`` runs the checks; ``gimpmd check service`` is the command for
users. The checks know the protocol only (``schemas/protocol.md``), so the service may be written in
any language.
"""
