"""Protocols, each implemented once and used for every method alike."""
