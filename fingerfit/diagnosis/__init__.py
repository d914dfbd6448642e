"""Where a model fails and which effect it lacks."""
