"""The data of a fit: measured segments, of which a model leaves residuals."""

from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.impact_table_data import TableData
from rock2d.diagnosis.residuals import Residuals

__all__ = ["Data", "Residuals"]

Data = FilmData | TableData
