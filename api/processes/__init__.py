"""The processes of a service: those that listen, those that compute."""
