"""Turn recordings into tables and figures."""
