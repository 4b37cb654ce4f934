"""Visualization: browser view, recordings and plots. It is imported only on demand."""
