"""Reports of finished jobs: one model of what is said, written as one HTML file or as a PDF."""
