/* Rows on ground that a frame carries; a part of kernel.c, see carried_ground.py.

   Such a row is the same function of the motion of frame a relative to frame b, the carrier, in the axes of b. Its
   wrench acts on a, and its opposite on b. */

static int is_carried(const Row *row)
{ return row->b >= 0 && (row->kind == WORLD || row->kind == OWN || row->kind == WHEEL || row->kind == ROLLING); }

/* Motion of a relative to b. The twist is about the origin of b. */
static void relative(const Motion *a, const Motion *b, Motion *out)
{
    double V[6], A[6], turned[6], d[3];
    subtract(a->V, b->V, V, 6), subtract(a->A, b->A, A, 6), subtract(a->p, b->p, d, 3);
    cross_motion(b->V, V, turned);
    add(A, -1.0, turned, 6);
    add_cross(V, V + 3, b->p), add_cross(A, A + 3, b->p);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out->R[3 * i + j] = b->R[i] * a->R[j] + b->R[3 + i] * a->R[3 + j] + b->R[6 + i] * a->R[6 + j];
    for (int half = 0; half < 6; half += 3)
        turn_back(b->R, V + half, out->V + half), turn_back(b->R, A + half, out->A + half);
    turn_back(b->R, d, out->p);
    memcpy(out->v, out->V, sizeof out->v);
    add_cross(out->v, out->V + 3, out->p);
}

/* A wrench in the axes of the carrier b, and its rate, in the world. */
static void to_world(const Wrench *own, const Motion *b, Wrench *out)
{
    double arm[3], moved[3];
    const double *w = b->V + 3;
    turn(b->R, own->p, arm), turn(b->R, own->pd, moved);
    for (int i = 0; i < 3; i++) out->p[i] = b->p[i] + arm[i], out->pd[i] = b->v[i] + moved[i];
    add_cross(out->pd, w, arm);
    turn(b->R, own->f, out->f), turn(b->R, own->m, out->m);
    turn(b->R, own->fd, out->fd), turn(b->R, own->md, out->md);
    add_cross(out->fd, w, out->f), add_cross(out->md, w, out->m);
}
