"""`make bench-service`: what a body costs, rates of the queue, what a second worker brings, workers at rest, full tables, two hundred clients for a minute."""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
from pathlib import Path

from bench.service import workers
from bench.service.bodies import costs
from bench.service.load import load
from bench.service.process import KEY, serving
from bench.service.resting import resting
from bench.service.tables import tables
from tests.support import postgres


def main() -> None:
    """Measure on both databases, and print."""
    parser = argparse.ArgumentParser(prog="make bench-service", description=__doc__)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--jobs", type=int, default=300, help="jobs that do nothing")
    parser.add_argument("--long", type=int, default=8, help="jobs that compute")
    parser.add_argument("--work", type=float, default=4.0, help="processor time of each of these, s")
    parser.add_argument("--processes", type=int, default=1, help="processes of the service that the clients ask")
    parser.add_argument("--resting", type=int, default=20, help="workers that have nothing to do, on Postgres")
    parser.add_argument("--rows", type=int, default=1_000_000, help="jobs and recordings in full tables, 0 for none")
    parser.add_argument(
        "--only",
        choices=("sqlite", "postgres", "resting"),
        help="let the clients ask this database, and no more; or let workers rest on Postgres, and no more",
    )
    given = parser.parse_args()
    if given.only == "resting":
        with postgres.server(max_connections="1000") as server:
            print(at_rest(postgres.create_database(server, "resting"), workers=given.resting))
        return
    print(f"load of the machine: {', '.join(f'{value:.1f}' for value in os.getloadavg())}; {os.cpu_count()} cores")
    for count, taken, refused in costs():
        print(f"a body of {count} keys, one twice: {1e6 * taken / count:.2f} us a key ({refused})")
    with tempfile.TemporaryDirectory() as folder, postgres.server(max_connections="1000") as server:
        for name in ("sqlite", "postgres") if given.only is None else (given.only,):

            def fresh(what: str, name: str = name) -> str:
                if name == "sqlite":
                    return f"sqlite:///{folder}/{what}.db"
                return postgres.create_database(server, what)

            if given.only is None:
                queue(name, fresh("rates"), jobs=given.jobs)
                lasted = workers.work(fresh("work"), jobs=given.long, seconds=given.work)
                print(
                    f"{name}: {given.long} jobs of {given.work:g} s: 1 worker {lasted[1]:.1f} s, 2 workers {lasted[2]:.1f} s, {lasted[1] / lasted[2]:.2f}x"
                )
                if name == "postgres":
                    print(at_rest(fresh("resting"), workers=given.resting))
                for what, taken in tables(fresh("tables"), count=given.rows) if given.rows else ():
                    print(
                        f"{name}: {given.rows:,} jobs, as many recordings, ten times as many events: {what} {1000 * taken:.1f} ms"
                    )
            with serving(fresh("load"), Path(folder) / f"{name}.log", processes=given.processes) as url:
                outcome = asyncio.run(load(url, KEY, clients=given.clients, seconds=given.seconds))
            times = ", ".join(
                f"p{100 * share:g} {1000 * outcome.percentile(share):.0f} ms" for share in (0.5, 0.9, 0.99)
            )
            print(
                f"{name}: {given.clients} clients, one request a second each: reads {times}; {dict(outcome.statuses)}, failed {dict(outcome.failures)}"
            )


def queue(name: str, url: str, *, jobs: int) -> None:
    """Print how fast jobs come and go, and what one takes from a database that is a server."""
    rates, spent = workers.rates(url, jobs=jobs)
    for what, rate in rates.items():
        print(f"{name}: jobs {what}: {rate:.0f}/s")
    if name == "postgres":
        print(f"{name}: a job takes {1000 * spent:.1f} ms of its processor time, from the request to its end")


def at_rest(url: str, *, workers: int) -> str:
    """Return the line of workers that have nothing to do."""
    rest = resting(url, workers=workers, seconds=30.0)
    return (
        f"postgres: {workers} workers at rest: {rest.cores:.3f} cores of the database, {rest.own:.3f} of each, "
        f"{rest.transactions:.1f} transactions a second and {rest.connections:.1f} connections of each"
    )


if __name__ == "__main__":
    main()
