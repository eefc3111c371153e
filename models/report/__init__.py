"""What all HTML reports have in common: the page and its style, figures as bytes, the table as drawn, numbers in words.

A report is values in, one file out: the module that writes it computes values and figures, its template in `templates/`
beside it holds every word of HTML and extends `page.html.j2` of this package.
"""
