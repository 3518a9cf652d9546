"""The bus. This is the only package that uses Zenoh.

The coupler is a router at one endpoint, a Unix socket or a port with TLS; every rank is a client
with one connection.

Ranks send *requests* to the coupler, and the coupler answers them. *Payloads* go from rank to rank:
each rank publishes its fields once per step, and the ranks of the other side subscribe to those
they need. Payloads pass through the coupler's process, but only through Zenoh's router, not
through Python.

All of them are publications, which may be lost when a connection breaks; the sender does not learn
of it. A request has a number, which its answer repeats, and it is sent again until the answer
arrives. A rank that misses a payload asks its sender for it again.
"""
