"""The pages in a real Chromium, against a real service on a real database."""
