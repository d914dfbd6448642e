"""From scores to constants: the problem, its rounds, slopes, the local minimum, intervals, the estimate."""
