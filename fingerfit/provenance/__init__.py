"""What each result was made from, whether it is whole, and why a job failed."""
