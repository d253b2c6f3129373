"""Claims and their verdicts: from values per run to estimates, intervals, verdicts and the ledger.

The line goes one way: `scenario.claims` (what may be written) -> `forms` (estimand and region of each cell) -> `plan`
(cells under each reading, families) -> `measure` on `replicates` (estimate and standard error) -> `verdict` (the one
rule) -> `ledger` (rows and claims) -> `records` (claims.csv, judging it again) and `words`.
"""
