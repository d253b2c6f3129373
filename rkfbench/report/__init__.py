"""Tables, figures and the report page of results folders; everything is read, nothing is computed anew.

The line goes one way: `scenario.display` (what may be declared) -> `material` (what of the results is picked) ->
`points` and `entries` (the data behind, which is the CSV) -> `figures` and `tables` (drawn and laid out) ->
`render` (written into the folder) and `page` (report.html and report.md).
"""
