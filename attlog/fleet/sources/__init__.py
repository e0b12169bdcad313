"""Where logs are: files, folders, archives, URLs."""
