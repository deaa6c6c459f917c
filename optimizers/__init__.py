"""How to choose parameters: problems, methods, results and their certificates, on top of the engine alone."""
