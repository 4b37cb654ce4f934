"""Plants whose contacts with the ground open and close by themselves."""
