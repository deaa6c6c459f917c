"""Errors as RFC 9457 problem documents, and the places in a document that they name."""
