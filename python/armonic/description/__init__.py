"""The robot file: its schema and units, how it is read with every error placed, how numbers are written back.

units.py numbers with units; fields.py, parts.py, actuation.py and schema.py what a file may say; document.py the text
and its lines; names.py its names against each other; reading.py from text to a checked description; tree.py, drives.py
and paths.py from description to arrays; numbers.py every number by its path; values.py new numbers in the old text;
from_urdf.py, urdf.py, urdf_elements.py and plain_xml.py files that start from a URDF.
"""
