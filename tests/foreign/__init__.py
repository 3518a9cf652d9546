"""The continuum service of ``examples/foreign-service``, which cargo builds."""
