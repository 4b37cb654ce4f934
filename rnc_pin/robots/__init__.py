"""Robot descriptions, models and names."""
