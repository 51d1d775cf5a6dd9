# SPDX-License-Identifier: Apache-2.0
# Draws what orbbuf-trial wrote, and no picture of what it did not. Usage: gnuplot -c plots.gp FOLDER
out = ARG1
there(name) = int(system("test -s '" . out . "/" . name . "' && echo 1 || echo 0"))
set terminal svg size 760,420 font "sans-serif,13" background "#ffffff"
set grid lc rgb "#dddddd"
set border 3 lc rgb "#666666"
set tics nomirror

set ylabel "outages survived (95 % interval)"
set yrange [0:1]
set style fill solid 0.9
set boxwidth 0.6
if (there("interruption.dat")) {
  set output out . "/paper_interruption.svg"
  plot out . "/interruption.dat" using 0:2:xtic(1) with boxes lc rgb "#0072b2" notitle, \
    "" using 0:2:3:4 with yerrorbars lc rgb "#222222" pt 0 notitle
}

set datafile separator comma
set xlabel "first missing frame"
set ylabel "missing frames in a row that lose the reference VO"
set yrange [0:80]
if (there("tolerance.csv")) {
  set output out . "/paper_tolerance.svg"
  plot out . "/tolerance.csv" every ::1 using 1:2 with linespoints pt 7 ps 0.5 lc rgb "#d55e00" notitle
}

set xlabel "distance in frames"
set ylabel "M(a, b)"
set yrange [0:*]
if (there("similarity.csv")) {
  set output out . "/paper_similarity.svg"
  plot out . "/similarity.csv" every ::1 using 1:3 with linespoints pt 7 ps 0.5 lc rgb "#009e73" title "mean", \
    "" every ::1 using 1:4 with linespoints pt 7 ps 0.5 lc rgb "#cc79a7" title "lowest"
}

set xlabel "frame"
set ylabel "time to enqueue, ms"
if (there("enqueue.csv")) {
  set output out . "/paper_enqueue.svg"
  plot out . "/enqueue.csv" every ::1 using 1:2 with impulses lc rgb "#0072b2" notitle
}

set xlabel "buffer, frames"
set ylabel "ATE, times the unbroken sequence's"
set logscale y
set yrange [0.2:30]
set style boxplot outliers pointtype 7
set boxwidth 1.6
set style fill solid 0.4
# A lost run counts as 25.
runs_of(size, policy) = sprintf("< awk -F, '$4 == %d && $5 == \"%s\" { print ($7 == \"inf\" ? 25 : $7) }' %s/traces.csv", size, policy, out)
sizes = there("traces.csv") ? int(system("cut -d, -f4 " . out . "/traces.csv | sort -u | wc -l")) - 1 : 0
if (sizes > 1) {
  set output out . "/paper_buffers.svg"
  plot for [size = 5:35:5] runs_of(size, "drop-oldest") using (size - 1.0):1 with boxplot lc rgb "#d55e00" pt 7 ps 0.3 title (size == 5 ? "drop-oldest" : ""), \
    for [size = 5:35:5] runs_of(size, "orbbuf") using (size + 1.0):1 with boxplot lc rgb "#0072b2" pt 7 ps 0.3 title (size == 5 ? "orbbuf" : "")
}
