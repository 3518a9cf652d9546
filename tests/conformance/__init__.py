"""All services under the check of a service, and all pairs of codes with the same wave."""
