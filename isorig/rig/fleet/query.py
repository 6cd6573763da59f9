"""SQL queries of the catalogue through DuckDB, if it is installed."""

from __future__ import annotations

import threading

import pyarrow as pa

from isorig.rig.errors import RigError, TimeLimitError
from isorig.rig.files.output import csv_text
from isorig.rig.fleet.catalogue import Catalogue

#: Limits of a query: seconds, rows of its result, and its memory. A fleet's catalogue has about 30 rows for each recording.
SECONDS, ROWS, MEMORY = 60.0, 1_000_000, "2GB"


def query_answers(catalogue: Catalogue, query: str) -> str:
    """The rows of a query as CSV; the table `answers` is the catalogue.

    The query can access this table only: no file, no network. Raises RigError if DuckDB is not installed, the query is empty or
    wrong, or its result is too long; TimeLimitError if the query takes longer than `SECONDS`.
    """
    try:
        import duckdb
    except ImportError:
        raise RigError("SQL needs DuckDB, which is not installed; install it with pip install 'isorig[sql]'") from None
    with duckdb.connect(config={"threads": 1, "memory_limit": MEMORY}) as connection:
        answers = catalogue.table()
        place = answers.schema.get_field_index("started")
        # Without its time zone, which is UTC: DuckDB would need another package to return it.
        connection.register("answers", answers.set_column(place, "started", answers.column(place).cast(pa.timestamp("us"))))
        connection.execute("set enable_external_access = false; set lock_configuration = true")
        late = threading.Timer(SECONDS, connection.interrupt)
        late.daemon = True
        late.start()
        try:
            if not connection.extract_statements(query):
                raise RigError("the query is empty; for example: select distinct rig from answers")
            found = connection.execute(query)
            names, rows = [column[0] for column in found.description or ()], found.fetchmany(ROWS + 1)
        except duckdb.InterruptException:
            raise TimeLimitError(
                f"the query took longer than {SECONDS:g} s; select fewer rows, or aggregate them in the query"
            ) from None
        except duckdb.Error as error:
            reason = (str(error).splitlines() or ["it failed"])[0]
            raise RigError(f"the query is wrong ({reason}); the table is answers, see docs/fleet.md for its columns") from None
        finally:
            late.cancel()
    if len(rows) > ROWS:
        raise RigError(f"the query has more than {ROWS} rows; add a limit, or aggregate them in the query")
    return csv_text(names, rows)
