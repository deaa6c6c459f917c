"""System documents, their exports, the catalogues."""
