"""What the installation itself needs."""
