"""What a service tells of itself: logs, traces, numbers for Prometheus."""
