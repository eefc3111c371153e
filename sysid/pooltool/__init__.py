"""pooltool's systems, written from a model and read as clips, without pooltool itself.

In: a `Model`, or files of pooltool's `System.save` and `MultiSystem.save`. Out: a file for `System.load` and one of
laws for `Resolver.load`, with the losses and their cost; or an `Imported` clip set.

    document    JSON and MessagePack, as pooltool writes and reads them
    frame       positions, velocities and spins converted between the two frames
    table       noses, jaws and pockets converted between the two programs
    laws        a model's constants as pooltool's, by the closest law; what has no counterpart
    losses      the cost of the losses, in mm, by cause
    export      the files, and the lines printed about them
    clips       systems as clips

Formats and laws are those of pooltool 0.6 (Kiefl, https://github.com/ekiefl/pooltool); files do not state the version.
"""
