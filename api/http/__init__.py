"""Requests and replies: limits, bodies, callers, headers, and how errors leave."""
