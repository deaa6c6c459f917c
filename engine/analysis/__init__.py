"""What is asked of one diagram: responses with their metrics, influence, prediction, limit cycles."""
