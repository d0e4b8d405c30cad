"""Histories and curves, their tables, files and pictures."""
