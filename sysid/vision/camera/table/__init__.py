"""What a picture shows of the table: cloth, edges, diamonds, balls; and which of its edges are the noses.

In: a picture and a rough camera. Out: points along the sides, a `CushionReading`, what speaks for it and against it.
"""
