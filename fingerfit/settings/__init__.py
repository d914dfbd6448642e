"""What a user chooses in config.yaml."""
