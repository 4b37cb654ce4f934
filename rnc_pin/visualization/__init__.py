"""Pictures: the browser, recordings, plots. Imported only where one is wanted."""
