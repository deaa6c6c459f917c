"""What the service does under load: `make bench-service`."""
