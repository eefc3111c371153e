"""What all commands have in common: programs of verbs, their options and outputs, and what they print.

program     verbs in sections, run; faults as one line
options     types of options, and the shared ones
outputs     outputs of verbs; no result is replaced without --overwrite
console     exit statuses, progress, tables, JSON
"""
