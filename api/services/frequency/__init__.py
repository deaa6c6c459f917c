"""Spectra and frequency response functions of recordings."""
