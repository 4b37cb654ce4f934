"""Browser: the drawing commands that a page receives, the page, the server, and the check of who may connect."""
