"""Loops with discontinuous elements, written twice: as a document for the engine, and as equations and switching rules by hand."""
