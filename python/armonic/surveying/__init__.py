"""Surveys of the workspace: tracked modes over paths, grids, samples and sweeps, checked to be complete."""

from armonic.surveying.running import survey
from armonic.surveying.walk import Grid, Sample, path

__all__ = ["Grid", "Sample", "path", "survey"]
