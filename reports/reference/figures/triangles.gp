# Error on the screen against visible triangles, one curve a renderer.  Draw it again: gnuplot triangles.gp > triangles.svg
set terminal svg size 1120,460 noenhanced font 'sans-serif,15' background '#ffffff' name 'triangles'
set encoding utf8
set datafile missing '?'
set border 3 lc rgb '#777777'
set tics nomirror tc rgb '#333333'
set grid lc rgb '#e6e6e6' lw 1 lt 1
set key at screen 0.5,0.9783 center top horizontal maxrows 1 Left reverse samplen 2 tc rgb '#222222'
set margins screen 0.09643, screen 0.97321, screen 0.15652, screen 0.89565
set xrange [2362.95031:1436841.97]
set yrange [0.224881996:17.0327587]
set logscale x
set xtics ('5 000' 5000, '10 000' 10000, '20 000' 20000, '50 000' 50000, '100 000' 100000, '200 000' 200000, '500 000' 500000, '1 000 000' 1000000)
set logscale y
set ytics ('0.5' 0.5, '1' 1, '2' 2, '5' 5, '10' 10)
set xlabel 'visible triangles, mean' offset 0,0.3
set ylabel 'error on the screen, p99.9 (px)'
set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2
set label 'n=63' at screen 0.26695,0.67357 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=511' at screen 0.78670,0.24211 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'tau=8' at screen 0.16697,0.70412 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=4' at screen 0.24884,0.55033 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=2' at screen 0.40465,0.43355 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=1' at screen 0.57233,0.32018 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=0.5' at screen 0.73164,0.18467 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'rows=150' at screen 0.40676,0.58784 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=210' at screen 0.49819,0.52621 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=300' at screen 0.59527,0.45679 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=424' at screen 0.68955,0.43350 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=600' at screen 0.78427,0.35164 center font 'sans-serif,12' tc rgb '#009E73'
set label 'step=2' at screen 0.95292,0.86750 center font 'sans-serif,12' tc rgb '#CC79A7'
plot 'triangles.dat' index 0 using 1:2 with linespoints lw 2.4 pt 7 ps 1 lc rgb '#0072B2' title 'clipmap', \
  'triangles.dat' index 1 using 1:2 with linespoints lw 2.4 pt 5 ps 1 lc rgb '#D55E00' title 'geomipmap', \
  'triangles.dat' index 2 using 1:2 with linespoints lw 2.4 pt 9 ps 1 lc rgb '#009E73' title 'pgm', \
  'triangles.dat' index 3 using 1:2 with linespoints lw 2.4 pt 13 ps 1 lc rgb '#CC79A7' title 'decimated'
