"""Webhooks and the alerts that they tell."""
