"""Recordings: imported, kept, processed, exported."""
