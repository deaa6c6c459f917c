"""What a user's scripts look like; run them from the root of the repository."""
