"""From a guess to what would have been measured: deck, prediction, score."""
