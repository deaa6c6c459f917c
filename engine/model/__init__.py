"""What every part of the engine speaks of: parameters, names, expressions, the document of a system, verdicts, traced numbers."""
