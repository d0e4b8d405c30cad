"""A page in the browser that plays a scenario anew while its numbers are moved: `balloons live`.

`controls` knows the numbers of a scenario, `links` what a page's address and a visitor's text may say,
`worker` computes in a process of its own, `figures` draws with Bokeh, `cards` and `inputs` are what is moved,
`page` puts all of it together with Panel, `server` lets nobody in but this machine, and `notebook` shows it
in one. Panel and Bokeh come with the extra `live`.
"""

MISSING = "the page needs Panel and Bokeh: pip install 'dielectric-balloons[live]'"
