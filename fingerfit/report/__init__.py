"""Tables, figures, the page, and exports."""
