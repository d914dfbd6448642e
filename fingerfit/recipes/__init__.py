"""Recipes that turn other people's data into studies."""
