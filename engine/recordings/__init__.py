"""What is measured: spectra, modes, processing, validation of models."""
