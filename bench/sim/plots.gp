# SPDX-License-Identifier: Apache-2.0
# Draws what orbbuf-sim wrote. Usage: gnuplot -c plots.gp DATA_FOLDER OUTPUT_FOLDER
data = ARG1
out = ARG2
names = "kitti05_stereo kitti06_mono picar_indoor tsukuba_synth generated"
colors = "#0072b2 #d55e00 #009e73 #56b4e9 #cc79a7"
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
set ylabel "largest step: the oracle's / the policy's"
set style data histogram
set style histogram clustered gap 1.5
set style fill solid 0.9 border -1
set yrange [0:1]
set xrange [*:*]
set xtics rotate by -30 noenhanced
set key outside top center horizontal
plot for [i=1:words(names)] name=word(names, i) (there(file("policies", name)) ? file("policies", name) : "/dev/null") \
       using 2:xtic(1) lc rgb word(colors, i) title name noenhanced

# The longest gap against the time until the stream is live again; a curve a policy.
set output out . "/lateness.svg"
set terminal svg size 900,760 font "sans-serif,13" background "#ffffff"
policies = "drop-oldest orbbuf uniform afr catch-up-full catch-up oracle"
policy_colors = "#999999 #d55e00 #0072b2 #e69f00 #56b4e9 #009e73 #000000"
set xtics norotate
set style data linespoints
set logscale xy
set xrange [*:*]
set yrange [0.5:*]
set xlabel "seconds until live again"
set ylabel "longest gap, frames"
set key bottom left inside vertical
set multiplot layout 2,2
do for [rate in "1.2 3"] {
  do for [name in "tsukuba_synth picar_indoor"] {
    set title sprintf("%s, link of %s times the need", name, rate) noenhanced
    if (there(file("curve", name))) {
      plot for [i=1:words(policies)] sprintf("< awk '$1 == %s && $2 == \"%s\"' %s", rate, word(policies, i), file("curve", name)) \
             using 3:($4 > 0.5 ? $4 : 0.5) lw 2 pt 7 ps 0.6 lc rgb word(policy_colors, i) title word(policies, i) noenhanced
    }
  }
}
unset multiplot
