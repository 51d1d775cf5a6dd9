# SPDX-License-Identifier: Apache-2.0
# Draws what orbbuf-sim wrote. Usage: gnuplot -c plots.gp DATA_FOLDER OUTPUT_FOLDER
data = ARG1
out = ARG2
names = "kitti05_stereo kitti06_mono picar_indoor generated"
colors = "#0072b2 #d55e00 #009e73 #cc79a7"
file(kind, name) = data . "/" . kind . "_" . name . ".dat"
there(path) = int(system("test -s '" . path . "' && echo 1 || echo 0"))

set terminal svg size 760,420 font "sans-serif,13" background "#ffffff"
set grid lc rgb "#dddddd"
set border 3 lc rgb "#666666"
set tics nomirror
set key right top

set output out . "/similarity.svg"
set xlabel "distance in frames"
set ylabel "M(a, b) as a share of M(a, a)"
set xrange [0:45]
set yrange [0:1]
plot for [i=1:words(names)] name=word(names, i) (there(file("distance", name)) ? file("distance", name) : "/dev/null") \
       using 1:2:4 with filledcurves fillcolor rgb word(colors, i) fillstyle transparent solid 0.12 notitle, \
     for [i=1:words(names)] name=word(names, i) (there(file("distance", name)) ? file("distance", name) : "/dev/null") \
       using 1:3 with lines lw 2 lc rgb word(colors, i) title name noenhanced

set output out . "/prediction.svg"
set xlabel "M(a, b) as a share of M(a, a), median at a distance"
set ylabel "epipolar inliers, mean at that distance"
set logscale xy
set xrange [0.005:1]
set yrange [5:1000]
set key left top
plot for [i=1:words(names)] name=word(names, i) (there(file("distance", name)) ? file("distance", name) : "/dev/null") \
       using ($3 > 0 ? $3 : NaN):5 with linespoints pt 7 ps 0.4 lc rgb word(colors, i) title name noenhanced

set output out . "/policies.svg"
unset logscale
set xlabel ""
set ylabel "smallest similarity, as a share of the clairvoyant's"
set style data histogram
set style histogram clustered gap 1.5
set style fill solid 0.9 border -1
set yrange [0:1]
set xrange [*:*]
set xtics rotate by -30 noenhanced
set key outside top center horizontal
plot for [i=1:words(names)] name=word(names, i) (there(file("policies", name)) ? file("policies", name) : "/dev/null") \
       using 2:xtic(1) lc rgb word(colors, i) title name noenhanced
