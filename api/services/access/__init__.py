"""Who may come in: keys, browsers, workspaces, the audit log."""
