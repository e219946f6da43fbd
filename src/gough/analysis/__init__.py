"""Mobility, redundancy and singularities of one configuration."""
