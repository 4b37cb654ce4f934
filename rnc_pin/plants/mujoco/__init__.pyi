"""Read by type checkers and editors, and by ``__init__.py`` to import each name when it is first used."""

from .plant import MuJoCoPlant as MuJoCoPlant
from .settings import MuJoCoSettings as MuJoCoSettings
