"""The application: routers, pages, the live socket, and the contract that it serves."""
