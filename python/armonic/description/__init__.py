"""The robot file: its schema and units, how it is read with every error placed, how fitted numbers are written back.

units.py numbers with units; fields.py and schema.py what a file may say; document.py the text and its lines; reading.py
from text to a checked description; tree.py from description to the arrays of a mechanism; values.py the numbers that a
fit may change.
"""
