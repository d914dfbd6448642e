"""What a user starts with: a draft of a study, a look at this machine, the results to open."""
