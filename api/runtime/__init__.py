"""What every process of a service stands on: its arguments, its children, its memory, what it shares with the others."""
