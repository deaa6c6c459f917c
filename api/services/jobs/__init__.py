"""Long work, and who may compute now."""
