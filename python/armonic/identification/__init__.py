"""Identification: from time series to modes, without and with a known input."""
