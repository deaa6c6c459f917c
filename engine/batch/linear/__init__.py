"""Responses of many linear systems without delays to any command, compiled: pieces of Chebyshev series, and what metrics read off them."""
