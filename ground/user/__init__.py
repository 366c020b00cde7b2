"""Files of the user: folders, the runtime files of `up`, settings."""
