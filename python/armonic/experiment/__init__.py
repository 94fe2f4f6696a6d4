"""From measured signals to frequency responses: hits, windows, spectra and estimators."""
