"""Own filters, models, noise laws, metrics and robust weights in a scenario: plug-ins, without a fork.

A plug-in is named wherever a catalogue name may stand:

    {use: my_filter.py:my_filter, threshold: 2}      a file, seen from the folder of the scenario
    {use: my_module:my_filter}                       my_module.py in that folder, or a module that Python can import
    {use: theirs}                                    an entry point of an installed package, group rkfbench.filters
                                                     (.models, .noises, .metrics, .weights)

    names     which file or module a name means; imports nothing but what a scenario names
    sources   the hash of a plug-in's sources, by which stored numbers are used again
    entry     from the named object to a catalogue entry: its signature has the parameters
    filters   the batch-last interface guarded
    onerun    the one-run interface looped over the runs
    parts     models, noise laws, robust weights and metrics
    draws     the random numbers of an own noise law
    faults    which plug-in an exception came from
"""

from rkfbench.own.names import beside, copies, is_reference, pins, ready, short, texts

__all__ = ["COPIES", "beside", "copies", "is_reference", "pins", "ready", "short", "texts"]

COPIES = "plugins"  # the folder beside stored results that holds the plug-ins' files
