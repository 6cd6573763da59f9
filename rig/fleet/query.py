"""SQL queries of the catalogue through DuckDB, if it is installed."""

from __future__ import annotations

import csv
import io

import pyarrow as pa

from isorig.rig.errors import RigError
from isorig.rig.fleet.catalogue import Catalogue


def asked(catalogue: Catalogue, query: str) -> str:
    """The rows of a query as CSV; the table `answers` is the catalogue.

    The query can access this table only: no file, no network.

    Raises
    ------
    RigError
        DuckDB is not installed, or the query is wrong.
    """
    try:
        import duckdb
    except ImportError:
        raise RigError("SQL needs DuckDB, which is not installed; install it with pip install 'isorig[sql]'") from None
    with duckdb.connect(config={"threads": 1}) as connection:
        answers = catalogue.table()
        place = answers.schema.get_field_index("started")
        # Without its time zone, which is UTC: DuckDB would need another package to return it.
        connection.register("answers", answers.set_column(place, "started", answers.column(place).cast(pa.timestamp("us"))))
        connection.execute("set enable_external_access = false; set lock_configuration = true")
        try:
            found = connection.execute(query)
            names, rows = [column[0] for column in found.description or ()], found.fetchall()
        except duckdb.Error as error:
            reason = (str(error).splitlines() or ["it failed"])[0]
            raise RigError(f"the query is wrong ({reason}); the table is answers, see docs/fleet.md for its columns") from None
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(names)
    table.writerows(rows)
    return text.getvalue()
