-- SPDX-License-Identifier: GPL-3.0-or-later
-- Who may do what in the queue of a fleet (deploy/docs/fleet.md). Run once by the owner of its tables, after the first
-- site has made them; again it changes nothing:
--   psql --dbname telefab --file fleet-roles.sql
--
-- A login role gets its rights by one of these groups. That of a scan site or fab has the site's name in the fleet:
--   CREATE ROLE chicago LOGIN IN ROLE telefab_submit;   \password chicago
--   CREATE ROLE la      LOGIN IN ROLE telefab_print;
--   CREATE ROLE ana     LOGIN IN ROLE telefab_operate;
--   CREATE ROLE bo      LOGIN IN ROLE telefab_administer;
BEGIN;

DO $$
DECLARE
  each text;
BEGIN
  FOREACH each IN ARRAY ARRAY['telefab_submit', 'telefab_print', 'telefab_operate', 'telefab_administer'] LOOP
    IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles WHERE rolname = each) THEN
      EXECUTE format('CREATE ROLE %I NOLOGIN', each);
    END IF;
  END LOOP;
  FOR each IN SELECT format('%I ON %I', policyname, tablename) FROM pg_catalog.pg_policies
              WHERE schemaname = current_schema AND policyname LIKE 'telefab_%' LOOP
    EXECUTE 'DROP POLICY ' || each;
  END LOOP;
END $$;

-- What is not said below nobody but the owner may.
GRANT SELECT ON fleet_version, fab, machine, fleet_job, lease, fleet_event
  TO telefab_submit, telefab_print, telefab_operate, telefab_administer;
GRANT INSERT ON fleet_event TO telefab_submit, telefab_print, telefab_operate, telefab_administer;
GRANT INSERT, UPDATE ON fleet_job TO telefab_submit;
GRANT UPDATE ON fleet_job TO telefab_print, telefab_operate, telefab_administer;
GRANT DELETE ON lease TO telefab_submit, telefab_print, telefab_operate, telefab_administer;
GRANT INSERT, UPDATE ON lease TO telefab_print;
GRANT INSERT, DELETE ON machine TO telefab_print;
GRANT UPDATE (profile, light, resin, width_mm, depth_mm, height_mm, pixel_mm, calibrated_unix_ms, readiness, seen_unix_ms)
  ON machine TO telefab_print;
GRANT INSERT, UPDATE ON fab TO telefab_print;
GRANT UPDATE (is_draining) ON machine TO telefab_administer;

ALTER TABLE fab ENABLE ROW LEVEL SECURITY;
ALTER TABLE machine ENABLE ROW LEVEL SECURITY;
ALTER TABLE fleet_job ENABLE ROW LEVEL SECURITY;
ALTER TABLE lease ENABLE ROW LEVEL SECURITY;
ALTER TABLE fleet_event ENABLE ROW LEVEL SECURITY;

-- Fabs and machines are no secret; a fab changes its own alone.
CREATE POLICY telefab_seen ON fab FOR SELECT USING (true);
CREATE POLICY telefab_own ON fab TO telefab_print USING (name = current_user) WITH CHECK (name = current_user);
CREATE POLICY telefab_seen ON machine FOR SELECT USING (true);
CREATE POLICY telefab_own ON machine TO telefab_print USING (fab = current_user) WITH CHECK (fab = current_user);
CREATE POLICY telefab_service ON machine FOR UPDATE TO telefab_administer USING (true);

-- A scan site sees its own jobs, and ends them before their first light (1 waiting, 2 claimed).
CREATE POLICY telefab_own ON fleet_job FOR SELECT TO telefab_submit USING (site = current_user);
CREATE POLICY telefab_new ON fleet_job FOR INSERT TO telefab_submit WITH CHECK (site = current_user AND state = 1);
CREATE POLICY telefab_end ON fleet_job FOR UPDATE TO telefab_submit
  USING (site = current_user AND state IN (1, 2)) WITH CHECK (site = current_user AND state = 7);
-- A fab sees what waits and what its machines have, or had; what has ended stays so (5 done, 6 failed, 7 cancelled).
CREATE POLICY telefab_open ON fleet_job FOR SELECT TO telefab_print USING (true);
CREATE POLICY telefab_print ON fleet_job FOR UPDATE TO telefab_print USING (state < 5) WITH CHECK (true);
CREATE POLICY telefab_all ON fleet_job FOR SELECT TO telefab_operate, telefab_administer USING (true);
CREATE POLICY telefab_cancel ON fleet_job FOR UPDATE TO telefab_operate
  USING (state IN (1, 2)) WITH CHECK (state = 7);
CREATE POLICY telefab_decide ON fleet_job FOR UPDATE TO telefab_administer USING (state < 5) WITH CHECK (true);

-- Of leases a scan site ends those of its own jobs, a fab has those of its own machines. What ran out every fab may end:
-- nobody else would end those of a fab that is gone.
CREATE POLICY telefab_seen ON lease FOR SELECT USING (true);
CREATE POLICY telefab_end ON lease FOR DELETE TO telefab_submit
  USING (is_bound = 0 AND EXISTS (SELECT FROM fleet_job f WHERE f.id = lease.job));
CREATE POLICY telefab_own ON lease TO telefab_print
  USING (EXISTS (SELECT FROM machine m WHERE m.name = lease.machine AND m.fab = current_user)
         OR until_unix_ms < (extract(epoch FROM clock_timestamp()) * 1000)::bigint);
CREATE POLICY telefab_cancel ON lease FOR DELETE TO telefab_operate USING (is_bound = 0);
CREATE POLICY telefab_decide ON lease FOR DELETE TO telefab_administer USING (true);

-- Events: a scan site those of its own jobs and of machines.
CREATE POLICY telefab_own ON fleet_event FOR SELECT TO telefab_submit
  USING (job = '' OR EXISTS (SELECT FROM fleet_job f WHERE f.id = fleet_event.job));
CREATE POLICY telefab_all ON fleet_event FOR SELECT TO telefab_print, telefab_operate, telefab_administer USING (true);
CREATE POLICY telefab_new ON fleet_event FOR INSERT WITH CHECK (true);

COMMIT;
