"""Schedules and their one clock."""
