"""The founding paper's methods."""
