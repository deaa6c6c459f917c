"""Recordings in text: tables of any laboratory, and those whose makers fixed their layout."""
