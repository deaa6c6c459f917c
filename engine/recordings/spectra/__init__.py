"""The Fourier analyser: exact spectra of simulated responses, estimated ones of recordings, harmonics, energy in a band."""
