"""Exports of ``rnc_pin.io``, which ``__init__.py`` imports at their first use."""

from .json import TEMPORARY_PREFIX as TEMPORARY_PREFIX
from .json import Json as Json
from .json import atomic_file as atomic_file
from .json import dump_json as dump_json
from .json import to_json_mapping as to_json_mapping
from .safe_read import LARGEST as LARGEST
from .safe_read import load_yaml as load_yaml
from .safe_read import open_regular as open_regular
from .safe_read import read_bytes as read_bytes
from .safe_read import recorded_reads as recorded_reads
from .strict_mapping import LIST as LIST
from .strict_mapping import Numbers as Numbers
from .strict_mapping import Strict as Strict
from .strict_mapping import descriptions as descriptions
from .strict_mapping import summary as summary
from .strict_mapping import validated as validated
from .strict_mapping import wrong as wrong
