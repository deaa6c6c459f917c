"""Side-by-side benchmarks against peers; each is one command and prints its ratios."""
