"""Are wrong formulas caught? Formulas of `models/` are broken one at a time, and the tests are run: `make mutation`."""
