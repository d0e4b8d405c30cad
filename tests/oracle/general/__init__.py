"""The reference for the whole grammar of scenarios."""
