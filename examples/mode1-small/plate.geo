// Mesh of the plate around the box of atoms, for Gmsh:  gmsh -2 plate.geo
//
// The mesh leaves open a box with the MD region and one cell of the grid around it. Along this box
// its vertices are the nodes of the grid; from there the elements grow towards the faces.

cell = 4;                                     // grid.cell of the case
coarse = 16;                                  // elements at the outer faces

Point(1) = {0, 0, 0, coarse};      Point(2) = {492, 0, 0, coarse};
Point(3) = {492, 452, 0, coarse};  Point(4) = {0, 452, 0, coarse};
Point(5) = {0, 308, 0, cell};      Point(6) = {228, 308, 0, cell};
Point(7) = {228, 144, 0, cell};    Point(8) = {0, 144, 0, cell};

Line(1) = {1, 2};  Line(2) = {2, 3};  Line(3) = {3, 4};  Line(4) = {4, 5};
Line(5) = {5, 6};  Line(6) = {6, 7};  Line(7) = {7, 8};  Line(8) = {8, 1};
Curve Loop(1) = {1:8};
Plane Surface(1) = {1};

Transfinite Curve {5, 7} = 228 / cell + 1;    // vertices at the nodes of the grid
Transfinite Curve {6} = 164 / cell + 1;

Recombine Surface {1};                        // quadrilaterals in place of triangles
Mesh.Algorithm = 8;
Mesh.MshFileVersion = 4.1;
