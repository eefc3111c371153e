"""pooltool's systems, written from a model and read as clips; pooltool itself is not needed for either.

In: a `Model`, or files that pooltool's `System.save` and `MultiSystem.save` wrote. Out: a file that `System.load` reads
and one of laws that `Resolver.load` reads, with what is lost on the way and what that costs; or an `Imported` clip set.

    document    JSON and MessagePack, as pooltool writes and reads them
    frame       places, velocities and spins between the two tables' frames
    table       noses, jaws and pockets there from ours, and back
    laws        a model's constants as pooltool's, by the law that comes nearest; what no law there has
    losses      what that costs, in mm, by cause
    export      the files, and what is said of them
    clips       systems as clips

Formats and laws are those of pooltool 0.6 (Kiefl, https://github.com/ekiefl/pooltool), which a file does not name.
"""
