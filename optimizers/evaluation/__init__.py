"""From a point to its goals: fast and exact values, excess over bounds, the certificate."""
